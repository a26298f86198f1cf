"""The manual's pages of the effects: text, a motion that shows each effect, and its picture."""

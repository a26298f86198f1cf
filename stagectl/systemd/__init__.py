"""Units, rules, and the one command that installs and removes them; what they say is filled in then."""

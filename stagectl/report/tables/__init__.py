"""Results as tables of text: what pages, the terminal and Python show alike, without matplotlib."""

"""Figures and self-contained HTML pages: the answer first, then the pictures, then how to do it again."""

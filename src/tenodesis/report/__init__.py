"""Presentation of results: the style of figures, the format of numbers and tables, and HTML pages."""

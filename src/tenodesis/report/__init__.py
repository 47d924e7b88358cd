"""How results are shown: one style of figures, one way to write numbers and tables, one maker of pages."""

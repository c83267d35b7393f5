"""What the build of the site makes by itself: formulas, docstrings, command, key and result pages, the room figure."""

"""Templates, style and scripts of the pages, and what fills them in: HTML in which every text is escaped."""

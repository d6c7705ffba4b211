"""Figures of the documents: which settings made each of them, the plan that makes all of them, the tables of the pages.

In order: `plan` (stages), `record` (what made a stored result), `pages`,
`status`, `making`.
"""

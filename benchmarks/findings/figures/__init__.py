"""Figures of the documents: which settings made each of them, the plan that makes all of them, the tables of the pages.

In come the plan and the stored results; out come results made anew, a record of what made each, and the tables in the
pages.

In order: `plan` (stages), `record` (what made a stored result), `pages`, `unfinished` (what is kept of long stages),
`making`.
"""

"""The measurements behind the documents, and the plan that runs them. Not shipped.

In come studies, seeds and stored results; out come the figures and tables that documents show.
"""

"""The measurements behind the documents, and the plan that runs them. Not shipped."""

"""From labelled events to candidate samples: the choice of the UV, the placement of the record, and what is left out.

This room does not know about sensing or about how samples are stored.
"""

"""Pictures of roads, with the sites beside them and the vehicles on them.

In come lanes, sites and paths; out come pictures, one of which moves.
"""

"""From a recording to labelled samples on disk."""

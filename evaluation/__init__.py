"""What a trained predictor is worth: on windows, live in traffic and in a closed loop; and the pages that say so.

In come a trained run and a dataset or a scenario; out come `metrics.json`, the answers behind it, and a page.
"""

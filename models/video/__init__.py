"""From pairs of videos, as of Brain4Cars, to the feature files of clips that CaSTFormer is trained on.

It needs an optional extra, `pip install '.[video]'` in a checkout: OpenCV reads videos and measures optical flow.
"""

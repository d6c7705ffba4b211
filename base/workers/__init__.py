"""Where tasks run: in processes of this machine, or on a cluster; and how what happens there is told.

In come a function and items; out comes a result for each item, or the reason why there is none.
"""

"""Where tasks run: in processes of this machine, or on a cluster; and on how many threads each computes."""

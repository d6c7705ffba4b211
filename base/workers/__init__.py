"""Where tasks run: in processes of this machine, or on a cluster; and how what happens there is told."""

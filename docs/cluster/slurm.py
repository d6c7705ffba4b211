"""Starts a cluster on SLURM, and keeps it while this script runs: docs/cluster.md says how."""

from dask_jobqueue import SLURMCluster
from distributed import Security

cluster = SLURMCluster(
    cores=16,
    processes=16,  # one thread per worker
    memory="32GB",
    walltime="08:00:00",
    interface="ib0",  # the network that the nodes share
    protocol="tls://",
    security=Security(),  # the certificates of dask's configuration
    scheduler_options={"port": 8786, "dashboard_address": "127.0.0.1:0"},
    job_script_prologue=["source ~/venv/bin/activate"],
)
cluster.scale(jobs=20)  # 320 workers
print(cluster.scheduler_address, flush=True)
input()  # keep the cluster until the job ends

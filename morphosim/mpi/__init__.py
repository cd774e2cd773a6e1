"""One large simulation over the ranks of an MPI job; see docs/mpi.md."""

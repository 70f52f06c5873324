"""Time steps on a GPU: the kernels of the CPU, compiled for CUDA, one particle per thread."""

NETS_AT_ONCE = 256  # number of nets of a study in one process

"""Stepping on a GPU: the kernels of the CPU, compiled for CUDA, one particle per thread."""

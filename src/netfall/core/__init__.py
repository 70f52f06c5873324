"""Foundation of all kernels: compilation, records of arguments, and vectors of numbers."""

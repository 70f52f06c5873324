"""Messages of the package `gpu`."""

from netfall.core.messages import Message

NO_DEVICE = Message(
    "E071",
    "--device gpu: no GPU that CUDA can use. Run with --device cpu",
    "`nvidia-smi` lists GPUs; only those of NVIDIA are supported. A Slurm job must ask for one, by --gpus=1.",
)
UNSUPPORTED = Message(
    "E072",
    "--device gpu: not possible with {features}. Run with --device cpu",
)
TOO_LARGE = Message(
    "E074",
    "the net needs {needed:.3g} GB of the GPU, and {free:.3g} GB of it are free. Run with --device cpu",
)
ON_CPU = Message("N073", "--device auto: the CPU is used: {reason}")

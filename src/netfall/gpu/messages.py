"""Messages of the package `gpu`."""

from netfall.core.messages import Message

NO_DEVICE = Message(
    "E071",
    "--device gpu: no GPU that CUDA can use. Run without --device gpu",
    "`nvidia-smi` lists GPUs; only those of NVIDIA are supported. A Slurm job must ask for one, by --gpus=1.",
)
UNSUPPORTED = Message(
    "E072",
    "--device gpu: not possible with {features}. Run without --device gpu",
)
TOO_LARGE = Message(
    "E074",
    "--device gpu: the net needs {needed:.3g} GB, and {free:.3g} GB of the device are free. Run without "
    "--device gpu",
)
ON_CPU = Message("N073", "--device auto: the CPU is used: {reason}")

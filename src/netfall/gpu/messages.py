"""Messages of the package `gpu`."""

from netfall.core.messages import Message

NO_DEVICE = Message("E071")
UNSUPPORTED = Message("E072")
TOO_LARGE = Message("E074")
ON_CPU = Message("N073")

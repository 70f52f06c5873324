"""Messages of the package `docs`."""

from netfall.core.messages import Message

UNKNOWN_TOPIC = Message("E051")

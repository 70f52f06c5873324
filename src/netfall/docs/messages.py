"""Messages of the package `docs`."""

from netfall.core.message import Message

UNKNOWN_TOPIC = Message("E051", "netfall docs {topic}: no such topic; {advice}")

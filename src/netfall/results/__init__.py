"""Result files: the parallel writer, checkpoints, locks, the reader, and text about results."""

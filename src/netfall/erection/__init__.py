"""The way to a prestress: targets reached by lengths, stages of erection. What a job names, as arrays."""

"""The model of a job: particles and elements with their loads, the time step, the distribution to ranks."""

"""What is recorded of a state: energies, envelope, history."""

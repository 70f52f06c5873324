"""Import of drawings and meshes: what is read, joined, held, split and left out."""

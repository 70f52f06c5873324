"""Import and export: drawings, meshes and files of other programs."""

"""Import and export of drawings, meshes and files of other programs."""

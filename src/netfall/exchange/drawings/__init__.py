"""Import of drawings and meshes: reading, joining of lines, supports, splitting, omissions."""

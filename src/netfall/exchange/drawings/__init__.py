"""Import of drawings and meshes: reading, joining, supports, splitting and omissions."""

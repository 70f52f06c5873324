"""Drawings and meshes in: what is read of them, joined, held, split and left out."""

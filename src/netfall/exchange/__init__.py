"""Drawings, meshes and files of other programs, in and out."""

"""The pages that the package ships: their generated parts, their printing by `netfall docs`, their site."""

"""Static equilibrium: Newton, interior point method, relaxation, limit load, reactions, form finding."""

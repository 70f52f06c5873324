"""Engineering checks of a result: utilisation by codes, cutting lengths, reactions."""

"""Numbers that an engineer asks of a result: utilisation by codes, cutting lengths, reactions."""

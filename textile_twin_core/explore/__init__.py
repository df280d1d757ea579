"""The design page: parameters in, moving linkage and curves out, person and computer optimise together."""

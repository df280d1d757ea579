"""Reference recordings and exact numbers for the tests, without any code of the engine."""

"""Design page: a person changes parameters, sees the linkage move, and searches for better designs."""

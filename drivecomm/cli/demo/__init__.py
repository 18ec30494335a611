"""Command `demo`: a tour of all features, on virtual lines or on a real one."""

"""What people type: one file an executable."""

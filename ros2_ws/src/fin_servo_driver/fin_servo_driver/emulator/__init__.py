"""A robot that is not there: devices that speak the makers' protocols on a pty, and the hidden fish that they move."""

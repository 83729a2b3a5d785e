"""An atlas of where methods lose stability: each beside its alternatives, from where it is fine to where it breaks."""

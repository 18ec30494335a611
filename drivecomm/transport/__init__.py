"""The only places that touch a port."""

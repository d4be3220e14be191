"""Speed against accuracy: what each setting of a scene costs, and what it changes."""

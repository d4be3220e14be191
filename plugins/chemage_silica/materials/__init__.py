"""Materials with silanol groups at their surface."""

"""The paper's figures and tables, computed anew and laid beside the published numbers."""

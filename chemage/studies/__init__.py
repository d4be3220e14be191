"""Many runs as one study: what to compute next (a design), where (a runner), and the folder of what is computed."""

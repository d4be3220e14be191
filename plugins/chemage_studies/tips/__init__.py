"""What scaling by contact area explains between tips and rough contacts."""

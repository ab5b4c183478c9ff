"""Images on their way into a network, and boxes on their way back."""

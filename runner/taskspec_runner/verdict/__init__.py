"""What a run came to: expectations over its history, metrics, and the words for them."""

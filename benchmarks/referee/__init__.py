"""Control laws of others, as they were published, and what drives a served plant with them."""

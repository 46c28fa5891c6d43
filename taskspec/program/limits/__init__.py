"""`solve: qp`: limits and contacts as the rows of two programs, and what solves them."""

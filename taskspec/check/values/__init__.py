"""TS1xx: values of the file that cannot be meant, whatever the stages do with them."""

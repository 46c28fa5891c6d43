"""TS6xx: stages that cannot begin or end as the file means it."""

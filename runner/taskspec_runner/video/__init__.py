"""Pictures of a run: videos, stills and a viewer, drawn from the folder that it left."""

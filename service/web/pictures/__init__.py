"""Pictures on the pages, drawn by the server: the cases of a campaign, its arms, its history, a mesh."""

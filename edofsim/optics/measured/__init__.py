"""PSFs that were measured, or computed elsewhere: their files, and what lies between them."""

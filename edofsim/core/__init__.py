"""What every room uses: it knows nothing of any of them."""

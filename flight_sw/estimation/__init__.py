"""What is estimated from navigation fixes: observers."""

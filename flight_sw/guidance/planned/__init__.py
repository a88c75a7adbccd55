"""x"""
LAWS: dict = {}

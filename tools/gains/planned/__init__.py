"""x"""
TABLES: dict = {}
FILLERS: dict = {}

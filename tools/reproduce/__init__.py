"""Published results flown again and set beside what the paper prints: a module a paper."""

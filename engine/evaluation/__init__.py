"""Measures of quality, speed and memory. They measure, the tests verify; nothing else imports them."""

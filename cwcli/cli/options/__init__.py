"""Options, declared once: the same name means the same thing in every command.

Precedence: flag over environment over configuration file over default.
"""

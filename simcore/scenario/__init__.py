"""The description of an insertion: blocks of fields, the rules between them, presets."""

"""Six pictures of 96 x 64 pixels, grey 0, 40, 80 to 200, as x265 and libvpx wrote them; one message each."""

from __future__ import annotations

from base64 import b64decode

H265 = [
    b64decode(text)
    for text in (
        "AAAAAUABDAH//wFgAAADAJAAAAMAAAMAHroCQAAAAAFCAQEBYAAAAwCQAAADAAADAB6gMIEFlukpMLmgIAAAAwAgAAADAUEAAAAB"
        "RAHAcYMSAAABKAGt0R7RF//TkXNVoAdwgnA=",
        "AAAAAQIB0Al4gbolwCQXOL9Ri/q27NLRKIYFpU3A",
        "AAAAAQIB0BH+IGyI8B97j5UVw+8Uhn0kD4A=",
        "AAAAAQIB0Bn+IGyJcISfc//VZ/q26KZ+IICHsEeA",
        "AAAAAQIB0CH+IG6JcISfc4vyLf+rbopn4oCHsEeA",
        "AAAAAQIB0Cn+IGyI8B97j5UVw+8Uhn0kD4A=",
    )
]

VP9 = [
    b64decode(text)
    for text in (
        "gkmDQgAF8AP2ADgkHBhKAAAwYAAAZz///1ZFZO8JUA==",
        "hgBAkvABQAAADGAAAAGj//9V/AACpcAA",
        "hgBAkvABO4AADGAAAAGj//67yAAFS4A=",
        "hgBAkvABQAAADGAAAAGj7uAABUuA",
        "hgBAkvABNQAADGAAAAGj//eAAAFS4A==",
        "hgBAkvABQAAADGAAAAGj//74+AACpcAA",
    )
]

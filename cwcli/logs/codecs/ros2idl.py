"""Message definitions in ROS 2's IDL (`ros2idl`) as `ros2msg` texts, by a parser that takes each word once.

Language: OMG IDL 4.2, as https://design.ros2.org/articles/idl_interface_definition.html uses it; a recording has the
definitions of a type one after the other, each behind a line of `=` and a line `IDL: package/msg/Name`. Comments,
annotations and the values of constants do not change the bytes of a message.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from cwcli.logs.codecs.ros2msg import MAX_DIGITS_OF_ARRAY_LENGTH, STRING_TYPE, WSTRING_TYPE, SchemaError

MAX_IDL_CHARACTERS = 1 << 18
"""The greatest length of a type's definitions, 256 Ki characters. Chosen by hand, as for ROS 1."""
MAX_MODULE_DEPTH = 16
"""The greatest number of modules inside each other. Chosen by hand: ROS has two."""
MAX_TYPEDEF_DEPTH = 16
"""The greatest number of names that stand for each other. Chosen by hand."""
ROS_TYPE_BY_IDL_WORDS = {
    **{each: each for each in ("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")},
    **{"boolean": "bool", "octet": "byte", "char": "uint8", "float": "float32", "double": "float64"},
    **{"short": "int16", "long": "int32", "long long": "int64"},
    **{"unsigned short": "uint16", "unsigned long": "uint32", "unsigned long long": "uint64"},
    **{"string": STRING_TYPE, "wstring": WSTRING_TYPE},
}
"""Words of a type in IDL -> primitive type of ROS 2."""
ENUM_TYPE = "uint32"
"""How an enumerated value is encoded (OMG XTypes 1.3, section 7.4.1)."""
_WORD_PATTERN = re.compile(
    r'\s+|//[^\n]*|/\*(?:.*?\*/|.*)|^#[^\n]*|^={3,}[^\n]*\nIDL:[^\n]*|("(?:[^"\\]|\\.)*"?|\'(?:[^\'\\]|\\.)*\'?|\w+|::|.)',
    re.MULTILINE | re.DOTALL,
)
"""The pattern of what is skipped, or of one word of the language; a comment that does not end takes the rest."""


class IdlType(NamedTuple):
    """A type: its name, in ROS or as IDL has it, and what stands behind it in `ros2msg` (`[]`, `[3]` or nothing)."""

    name: str
    array: str


def ros2msg_text_of_idl(type_name: str, text: str) -> str:
    """Return the definition of a type with all that it uses in `ros2msg`.

    Raises:
        SchemaError: The text is too long, can't be understood, or does not define the type.
    """
    if len(text) > MAX_IDL_CHARACTERS:
        raise SchemaError(f"the definition has {len(text):,} characters, more than {MAX_IDL_CHARACTERS:,}")
    parser = _IdlParser(text)
    parser.parse()
    root = type_name.replace("/", "::")
    if root not in parser.structs:
        raise SchemaError(f"the definition in IDL does not define {type_name}")
    text_by_name: dict[str, str] = {}
    waiting = [root]
    while waiting:
        name = waiting.pop()
        if name not in text_by_name and name in parser.structs:
            lines = [f"MSG: {name.replace('::', '/')}\n"] if text_by_name else []
            known: dict[IdlType, IdlType] = {}
            for field_name, declared in parser.structs[name]:
                found = known[declared] = known.get(declared) or parser.resolve(declared, name)
                waiting.append(found.name)
                lines.append(f"{found.name.replace('::', '/')}{found.array} {field_name}\n")
            text_by_name[name] = "".join(lines)
    return ("=" * 80 + "\n").join(text_by_name.values())


class _IdlParser:
    """The words of a text, and what they define, by names with `::`; constants by their last name."""

    def __init__(self, text: str) -> None:
        self._words: Iterator[str] = (found[1] for found in _WORD_PATTERN.finditer(text) if found[1])
        self._word = next(self._words, "")
        self.structs: dict[str, list[tuple[str, IdlType]]] = {}
        self.typedefs: dict[str, IdlType] = {}
        self.constants: dict[str, str] = {}

    def parse(self) -> None:
        """Parse all definitions.

        Raises:
            SchemaError: A word is not expected.
        """
        modules: list[str] = []
        while self._word:
            self._skip_annotations()
            word = self._take()
            if word == "module":
                modules.append(self._take())
                self._take("{")
                if len(modules) > MAX_MODULE_DEPTH:
                    raise SchemaError(f"modules are more than {MAX_MODULE_DEPTH} deep inside each other")
            elif word == "}" and modules:
                modules.pop()
                self._take(";")
            elif word == "struct":
                self._parse_struct("::".join((*modules, self._take())))
            elif word == "typedef":
                declared = self._take_type()
                for name, kind in self._declarators(declared):
                    self.typedefs["::".join((*modules, name))] = kind
            elif word == "const":
                self._take_type()
                name = self._take()
                self._take("=")
                self.constants[name] = "".join(self._words_before(";"))
            elif word == "enum":
                self.typedefs["::".join((*modules, self._take()))] = IdlType(ENUM_TYPE, "")
                self._words_before(";")
            else:
                raise SchemaError(f"{word[:40]!r} begins no definition of IDL that is read")

    def resolve(self, declared: IdlType, scope: str) -> IdlType:
        """Return a type without names that stand for others, as seen from a scope.

        Raises:
            SchemaError: It is an array of arrays, or names stand for each other without end.
        """
        name, array = declared
        for _ in range(MAX_TYPEDEF_DEPTH):
            candidates = ["::".join((*scope.split("::")[:k], name)) for k in range(scope.count("::") + 1, -1, -1)]
            found = next((each for each in candidates if each in self.typedefs or each in self.structs), name)
            if found not in self.typedefs:
                return IdlType(found, array)
            if array and self.typedefs[found].array:
                raise SchemaError("an array of arrays is not read")
            name, array, scope = self.typedefs[found].name, array or self.typedefs[found].array, found
        raise SchemaError(f"more than {MAX_TYPEDEF_DEPTH} names stand for each other")

    def _parse_struct(self, name: str) -> None:
        self._take("{")
        fields: list[tuple[str, IdlType]] = []
        while True:
            self._skip_annotations()
            if self._word == "}":
                break
            fields += self._declarators(self._take_type())
        self._take("}")
        self._take(";")
        self.structs[name] = fields

    def _declarators(self, declared: IdlType) -> list[tuple[str, IdlType]]:
        """Take names up to the semicolon, each with the length of its array if it has one."""
        found = []
        while True:
            name = self._take()
            array = declared.array
            if self._word == "[":
                if array:
                    raise SchemaError("an array of arrays is not read")
                self._take("[")
                array = f"[{self._length(self._words_before(']'))}]"
            found.append((name, IdlType(declared.name, array)))
            separator = self._take()
            if separator != ",":
                break
        if separator != ";":
            raise SchemaError(f"{separator[:40]!r} stands where `;` should")
        return found

    def _length(self, words: list[str]) -> int:
        """Return the length that a number or the name of a constant says."""
        text = self.constants.get(words[-1] if words else "", "".join(words))
        if not re.fullmatch(r"[0-9]+", text) or len(text) > MAX_DIGITS_OF_ARRAY_LENGTH:
            raise SchemaError(f"{text[:40]!r} is no length of an array")
        return int(text)

    def _take_type(self) -> IdlType:
        word = self._take()
        if word == "sequence":
            self._take("<")
            if self._word == "sequence":
                raise SchemaError("an array of arrays is not read")
            element_type = self._take_type()
            self._words_before(">")
            return IdlType(element_type.name, "[]")
        if word in ("unsigned", "long"):
            while self._word in ("short", "long"):
                word += f" {self._take()}"
        if word in (STRING_TYPE, WSTRING_TYPE) and self._word == "<":
            self._words_before(">")
        if word in ROS_TYPE_BY_IDL_WORDS:
            return IdlType(ROS_TYPE_BY_IDL_WORDS[word], "")
        name = word if word != "::" else self._take()
        while self._word == "::":
            name += self._take() + self._take()
        if not re.fullmatch(r"[A-Za-z_]\w*(::\w+)*", name):
            raise SchemaError(f"{name[:40]!r} is no type of IDL that is read")
        return IdlType(name, "")

    def _skip_annotations(self) -> None:
        """Skip `@name` and `@name(...)`."""
        while self._word == "@":
            self._take()
            self._take()
            if self._word == "(":
                n_open = 0
                while True:
                    word = self._take()
                    n_open += (word == "(") - (word == ")")
                    if not n_open:
                        break

    def _words_before(self, last: str) -> list[str]:
        """Take words up to one, which is taken, too."""
        found = []
        while (word := self._take()) != last:
            found.append(word)
        return found

    def _take(self, expected: str = "") -> str:
        """Take the next word, which must be the expected one if one is."""
        word = self._word
        if not word or (expected and word != expected):
            raise SchemaError(
                f"{word[:40]!r} stands where {expected or 'more'!r} should" if word else "it ends too early"
            )
        self._word = next(self._words, "")
        return word

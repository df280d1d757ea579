"""Named tuples that compiled functions hand on by reference: one address instead of seven numbers for each array.

numba by itself takes a tuple apart at every call and puts it together again in the function: of forty functions that
hand on forty arrays most of what is compiled is that, and most of the time that compiling takes.
"""

from __future__ import annotations

from itertools import accumulate
from typing import Any

from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed, lower_getattr_generic
from numba.core.types import Type
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, models, register_model, typeof_impl, unbox

_WORD = 8


def pass_by_reference(kind: type[tuple[Any, ...]]) -> None:
    """Let compiled functions take named tuples of this kind, and read their fields."""
    typeof_impl.register(kind)(_type_of)


class _Reference(Type):
    """Address of the fields of a named tuple, which stay as they are as long as it is known."""

    def __init__(self, kind: Any, fields: tuple[Any, ...]) -> None:
        self.fields = dict(zip(kind._fields, fields, strict=True))
        self.places: tuple[int, ...] = ()
        super().__init__(f"&{kind.__module__}.{kind.__qualname__}({', '.join(map(str, fields))})")


def _type_of(value: tuple[Any, ...], context: Any) -> _Reference:
    return _Reference(type(value), tuple(typeof_impl(field, context) for field in value))


@register_model(_Reference)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: _Reference) -> None:
        super().__init__(manager, kind, cgutils.voidptr_t)


def _places(context: Any, kind: _Reference) -> tuple[int, ...]:
    """Where the fields lie [bytes], then where they end."""
    if not kind.places:
        sizes = [context.get_abi_sizeof(context.get_value_type(field)) for field in kind.fields.values()]
        kind.places = tuple(accumulate([-(-size // _WORD) * _WORD for size in sizes], initial=0))
    return kind.places


def _from_python(kind: _Reference, value: Any, c: Any) -> Any:
    """Write the fields down for the time of a call."""
    *places, end = _places(c.context, kind)
    content = cgutils.alloca_once(c.builder, cgutils.intp_t, end // _WORD)
    wrong, natives = cgutils.false_bit, []
    for number, (place, field) in enumerate(zip(places, kind.fields.values(), strict=True)):
        native = c.unbox(field, c.pyapi.tuple_getitem(value, number))
        address = cgutils.pointer_add(c.builder, content, place, native.value.type.as_pointer())
        c.builder.store(native.value, address)
        wrong = c.builder.or_(wrong, native.is_error)
        natives.append((field, native))

    def cleanup() -> None:
        for field, native in natives:
            if native.cleanup is not None:
                native.cleanup()
            if c.context.enable_nrt:
                c.context.nrt.decref(c.builder, field, native.value)

    # What reads the fields may do so at any time after this, but not before.
    barrier_type = cgutils.ir.FunctionType(cgutils.voidptr_t, [content.type])
    barrier = cgutils.ir.InlineAsm(barrier_type, "", "=r,0,~{memory}", side_effect=True)
    return NativeValue(c.builder.call(barrier, [content]), wrong, cleanup)


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    key = _Reference

    def generic_resolve(self, kind: _Reference, name: str) -> Any:
        """The type of a field."""
        return kind.fields.get(name)


def _read(context: Any, builder: Any, kind: _Reference, address: Any, name: str) -> Any:
    """A field."""
    field, place = kind.fields[name], dict(zip(kind.fields, _places(context, kind), strict=False))[name]
    to_field = context.get_value_type(field).as_pointer()
    value = builder.load(cgutils.pointer_add(builder, address, place, to_field))
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return impl_ret_borrowed(context, builder, field, value)


unbox(_Reference)(_from_python)
lower_getattr_generic(_Reference)(_read)

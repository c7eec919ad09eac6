import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from chamfer.analysis.campaign.trial_rows import decode, encode

VALUES = st.none() | st.booleans() | st.integers() | st.floats() | st.text()
ARRAYS = arrays.arrays(
    st.sampled_from([np.float64, np.float32, np.int64, np.uint8, np.bool_, np.dtype("<U5")]),
    arrays.array_shapes(min_dims=0, min_side=0, max_side=4),
)


@given(st.dictionaries(st.text(), VALUES | ARRAYS))
def test_a_row_comes_back_as_it_was(row: dict[str, object]) -> None:
    found = decode(encode(row))
    assert list(found) == list(row)
    for name, value in row.items():
        if isinstance(value, np.ndarray):
            assert (found[name].dtype, found[name].shape) == (value.dtype, value.shape)
            assert found[name].tobytes() == value.tobytes()
        else:
            assert type(found[name]) is type(value)
            assert repr(found[name]) == repr(value)  # also for NaN and -0.0


def test_numbers_of_numpy_become_pythons() -> None:
    found = decode(encode({"a": np.float32(0.5), "b": np.int8(3), "c": np.bool_(True)}))
    assert found == {"a": 0.5, "b": 3, "c": True}
    assert [type(value) for value in found.values()] == [float, int, bool]


def test_an_array_may_lie_in_memory_in_any_way() -> None:
    table = np.arange(12.0).reshape(3, 4)
    row = {"transposed": table.T, "part": table[::2, 1], "fortran": np.asfortranarray(table)}
    for name, value in decode(encode(row)).items():
        np.testing.assert_array_equal(value, row[name])


@pytest.mark.parametrize("value", [(1, 2), [1.0], {"a": 1}, object(), b"bytes", 1j])
def test_what_is_no_value_of_a_row_is_named(value: object) -> None:
    with pytest.raises(TypeError, match=r"^found is of type .*, allowed: a number, a text, "):
        encode({"other": 1.0, "found": value})


def test_objects_are_neither_written_nor_read() -> None:
    with pytest.raises(TypeError, match="found is an array of objects"):
        encode({"found": np.array([object()])})
    pickled = encode({"found": np.array([1.0])}).replace(b"'<f8'", b"'|O' ")
    with pytest.raises(ValueError, match="allow_pickle=False"):
        decode(pickled)

//! The memory layout of the messages as data: checked at compile time to have no padding, and hashed so that peers can compare it.
//!
//! iceoryx2 compares the type's name, size and alignment when a service is opened; two fields swapped would pass. The hash of every field's
//! name, offset, size and scalar type goes into the service's attributes and closes that gap.

/// One field of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// The name in Rust, C and Python.
    pub name: &'static str,
    /// Bytes from the start of the message.
    pub offset: usize,
    /// Bytes of the field; an array has size ÷ size of its scalar entries.
    pub size: usize,
    /// The scalar type: `u8`, `u32`, `u64`, `f32`, `f64`, or the name of a nested struct.
    pub scalar: &'static str,
}

/// A message with a known layout.
pub trait Layout {
    /// The fields, in order, without gaps.
    const FIELDS: &'static [Field];

    /// FNV-1a over `name:offset:size:scalar;` of every field.
    const LAYOUT_HASH: u64 = hash_of(Self::FIELDS);
}

/// What a field can be made of.
pub(crate) trait Scalar {
    const NAME: &'static str;
}

macro_rules! scalars {
    ($($scalar:ident),+) => { $(impl Scalar for $scalar { const NAME: &'static str = stringify!($scalar); })+ };
}
scalars!(u8, u32, u64, f32, f64);

impl<T: Scalar, const N: usize> Scalar for [T; N] {
    const NAME: &'static str = T::NAME;
}

/// The field that `_select` picks; its size and type come from the compiler, not from a second declaration.
pub(crate) const fn field<S, F: Scalar>(name: &'static str, offset: usize, _select: fn(&S) -> &F) -> Field {
    Field { name, offset, size: size_of::<F>(), scalar: F::NAME }
}

/// Panics (at compile time) unless the fields follow each other without gaps up to `size`.
pub(crate) const fn assert_gapless(fields: &[Field], size: usize) {
    let mut end = 0;
    let mut index = 0;
    while index < fields.len() {
        assert!(fields[index].offset == end, "a field does not follow the one before it: padding, or out of order");
        end += fields[index].size;
        index += 1;
    }
    assert!(end == size, "padding at the end, or a field is missing from the list");
}

/// Implements [`Layout`] for a `repr(C)` struct, and asserts at compile time that all its fields are listed, in order, without padding.
macro_rules! layout {
    ($name:ident: $size:literal { $($field:ident @ $offset:literal),+ $(,)? }) => {
        impl $crate::layout::Layout for $name {
            const FIELDS: &'static [$crate::layout::Field] = &[
                $($crate::layout::field::<$name, _>(stringify!($field), std::mem::offset_of!($name, $field), |message| &message.$field)),+
            ];
        }
        const _: () = {
            assert!(size_of::<$name>() == $size, "the size of a published message changed");
            $(assert!(std::mem::offset_of!($name, $field) == $offset, "the offset of a published field changed");)+
            $crate::layout::assert_gapless(<$name as $crate::layout::Layout>::FIELDS, size_of::<$name>());
        };
    };
}
pub(crate) use layout;

const FNV_OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const FNV_PRIME: u64 = 0x0000_0100_0000_01b3;

const fn hash_bytes(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut index = 0;
    while index < bytes.len() {
        hash = (hash ^ bytes[index] as u64).wrapping_mul(FNV_PRIME);
        index += 1;
    }
    hash
}

const fn hash_number(hash: u64, number: usize) -> u64 {
    let mut digits = [0; 20];
    let mut start = digits.len();
    let mut rest = number;
    loop {
        start -= 1;
        digits[start] = b'0' + (rest % 10) as u8;
        rest /= 10;
        if rest == 0 {
            break;
        }
    }
    hash_bytes(hash, digits.split_at(start).1)
}

const fn hash_of(fields: &[Field]) -> u64 {
    let mut hash = FNV_OFFSET;
    let mut index = 0;
    while index < fields.len() {
        hash = hash_bytes(hash, fields[index].name.as_bytes());
        hash = hash_bytes(hash, b":");
        hash = hash_number(hash, fields[index].offset);
        hash = hash_bytes(hash, b":");
        hash = hash_number(hash, fields[index].size);
        hash = hash_bytes(hash, b":");
        hash = hash_bytes(hash, fields[index].scalar.as_bytes());
        hash = hash_bytes(hash, b";");
        index += 1;
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_fnv_1a_of_the_described_text() {
        // FNV-1a test vector of the authors: "foobar".
        assert_eq!(hash_bytes(FNV_OFFSET, b"foobar"), 0x8594_4171_f739_67e8);
        let fields = [Field { name: "a", offset: 0, size: 4, scalar: "u32" }, Field { name: "bc", offset: 1040, size: 12, scalar: "f32" }];
        assert_eq!(hash_of(&fields), hash_bytes(FNV_OFFSET, b"a:0:4:u32;bc:1040:12:f32;"));
    }

    #[test]
    fn swapped_fields_change_the_hash() {
        let first = Field { name: "a", offset: 0, size: 4, scalar: "u32" };
        let second = Field { name: "b", offset: 4, size: 4, scalar: "u32" };
        let swapped = [Field { name: "b", ..first }, Field { name: "a", ..second }];
        assert_ne!(hash_of(&[first, second]), hash_of(&swapped));
    }

    #[test]
    #[should_panic(expected = "padding")]
    fn a_gap_is_found() {
        assert_gapless(
            &[Field { name: "a", offset: 0, size: 4, scalar: "u32" }, Field { name: "b", offset: 8, size: 8, scalar: "u64" }],
            16,
        );
    }
}

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

    /// Where the bytes begin that were reserved when this version of the messages was made.
    const RESERVED_FROM: usize;

    /// FNV-1a over `name:offset:size:scalar;` of every field before [`Layout::RESERVED_FROM`], and of all bytes from there on as one field
    /// `reserved`: naming some of them later does not change the hash.
    const LAYOUT_HASH: u64 = hash_of(Self::FIELDS, Self::RESERVED_FROM);
}

/// The types that fields can have.
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

/// Panics (at compile time) unless the fields follow each other without gaps up to `size`, and one begins at `reserved_from` or they end
/// there.
pub(crate) const fn assert_gapless(fields: &[Field], reserved_from: usize, size: usize) {
    let mut end = 0;
    let mut index = 0;
    let mut begins_reserved = reserved_from == size;
    while index < fields.len() {
        begins_reserved = begins_reserved || fields[index].offset == reserved_from;
        assert!(fields[index].offset == end, "a field does not follow the one before it: padding, or out of order");
        end += fields[index].size;
        index += 1;
    }
    assert!(end == size, "padding at the end, or a field is missing from the list");
    assert!(begins_reserved, "no field begins where the reserved bytes do");
}

/// Implements [`Layout`] for a `repr(C)` struct, and asserts at compile time that all its fields are listed, in order, without padding.
macro_rules! layout {
    ($name:ident: $size:literal, reserved from $reserved:literal { $($field:ident @ $offset:literal),+ $(,)? }) => {
        impl $crate::layout::Layout for $name {
            const FIELDS: &'static [$crate::layout::Field] = &[
                $($crate::layout::field::<$name, _>(stringify!($field), std::mem::offset_of!($name, $field), |message| &message.$field)),+
            ];
            const RESERVED_FROM: usize = $reserved;
        }
        const _: () = {
            assert!(size_of::<$name>() == $size, "the size of a published message changed");
            $(assert!(std::mem::offset_of!($name, $field) == $offset, "the offset of a published field changed");)+
            $crate::layout::assert_gapless(<$name as $crate::layout::Layout>::FIELDS, $reserved, size_of::<$name>());
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

const fn hash_field(hash: u64, field: &Field) -> u64 {
    let hash = hash_bytes(hash_bytes(hash, field.name.as_bytes()), b":");
    let hash = hash_bytes(hash_number(hash, field.offset), b":");
    let hash = hash_bytes(hash_number(hash, field.size), b":");
    hash_bytes(hash_bytes(hash, field.scalar.as_bytes()), b";")
}

const fn hash_of(fields: &[Field], reserved_from: usize) -> u64 {
    let mut hash = FNV_OFFSET;
    let mut reserved = 0;
    let mut index = 0;
    while index < fields.len() {
        if fields[index].offset < reserved_from {
            hash = hash_field(hash, &fields[index]);
        } else {
            reserved += fields[index].size;
        }
        index += 1;
    }
    if reserved == 0 {
        return hash;
    }
    hash_field(hash, &Field { name: "reserved", offset: reserved_from, size: reserved, scalar: "u8" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_fnv_1a_of_the_described_text() {
        // FNV-1a test vector of the authors: "foobar".
        assert_eq!(hash_bytes(FNV_OFFSET, b"foobar"), 0x8594_4171_f739_67e8);
        let fields = [Field { name: "a", offset: 0, size: 4, scalar: "u32" }, Field { name: "bc", offset: 1040, size: 12, scalar: "f32" }];
        assert_eq!(hash_of(&fields, 1052), hash_bytes(FNV_OFFSET, b"a:0:4:u32;bc:1040:12:f32;"));
    }

    #[test]
    fn swapped_fields_change_the_hash() {
        let first = Field { name: "a", offset: 0, size: 4, scalar: "u32" };
        let second = Field { name: "b", offset: 4, size: 4, scalar: "u32" };
        let swapped = [Field { name: "b", ..first }, Field { name: "a", ..second }];
        assert_ne!(hash_of(&[first, second], 8), hash_of(&swapped, 8));
    }

    #[test]
    fn naming_reserved_bytes_leaves_the_hash_and_moving_them_does_not() {
        let first = Field { name: "a", offset: 0, size: 4, scalar: "u32" };
        let rest = |offset, size| Field { name: "reserved", offset, size, scalar: "u8" };
        let named = Field { name: "b", offset: 4, size: 8, scalar: "f64" };
        let hash = hash_of(&[first, rest(4, 20)], 4);
        assert_eq!(hash_of(&[first, named, rest(12, 12)], 4), hash);
        assert_ne!(hash_of(&[first, rest(4, 28)], 4), hash, "another size");
        assert_ne!(hash_of(&[first, named, rest(12, 12)], 12), hash, "another place");
    }

    #[test]
    #[should_panic(expected = "padding")]
    fn a_gap_is_found() {
        assert_gapless(
            &[Field { name: "a", offset: 0, size: 4, scalar: "u32" }, Field { name: "b", offset: 8, size: 8, scalar: "u64" }],
            16,
            16,
        );
    }
}

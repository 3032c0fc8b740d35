//! Words of scenes and files: each is spelt once, beside the variant that it stands for.

/// Gives an enum of unit variants its words: constants `ALL` and `NAMES`, a method `name`, and serde's two traits, which
/// read and write the word alone.
macro_rules! words {
    ($type:ident { $($variant:ident = $word:literal),+ $(,)? }) => {
        impl $type {
            /// Every variant.
            pub const ALL: [Self; [$($word),+].len()] = [$(Self::$variant),+];
            /// The word for every variant, in the order of [`ALL`](Self::ALL).
            pub const NAMES: [&'static str; [$($word),+].len()] = [$($word),+];

            /// The word for it in scenes and files.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $word,)+
                }
            }
        }

        impl serde::Serialize for $type {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(self.name())
            }
        }

        impl<'de> serde::Deserialize<'de> for $type {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let word = <String as serde::Deserialize>::deserialize(deserializer)?;
                let found = Self::ALL.into_iter().find(|variant| variant.name() == word);
                found.ok_or_else(|| serde::de::Error::unknown_variant(&word, &Self::NAMES))
            }
        }
    };
}
pub(crate) use words;

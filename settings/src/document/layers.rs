//! Parts of a document as documents of their own, and documents laid over each other: how a file holds several sets of
//! the same settings.

use std::collections::BTreeMap;

use super::Document;
use crate::error::{Error, Place};

impl Document {
    /// The sections right below `section`, by their own names, in the order in which the text names them first; and
    /// where that is. A name that is no bare key is given in quotes.
    ///
    /// # Errors
    /// If something below `section` is no section.
    pub fn sections_in(&self, section: &str) -> Result<Vec<(String, Place)>, Error> {
        self.refuse_value(section)?;
        if let Some(table) = self.tables.get(section)
            && let Some(entry) = table.entries.values().min_by_key(|entry| &entry.place)
        {
            return Err(entry.found.should_be("a section".to_owned()));
        }
        let mut found: BTreeMap<String, Place> = BTreeMap::new();
        for (name, table) in &self.tables {
            if let Some(rest) = below(section, name) {
                let first = if rest.starts_with('"') {
                    rest
                } else {
                    rest.split('.').next().unwrap_or(rest)
                };
                let place = found.entry(first.to_owned()).or_insert_with(|| table.place.clone());
                *place = place.clone().min(table.place.clone());
            }
        }
        let mut found: Vec<_> = found.into_iter().collect();
        found.sort_by(|(_, one), (_, other)| one.cmp(other));
        Ok(found)
    }

    /// What stands in the sections below `section`, as a document of its own, in which `[section.a.b]` is `[a.b]`. Its
    /// errors still name the keys in full. The keys of `section` itself stay behind.
    pub fn below(&self, section: &str) -> Self {
        let tables = self.tables.iter().filter_map(|(name, table)| {
            let rest = below(section, name)?;
            Some((rest.to_owned(), table.clone()))
        });
        Self {
            tables: tables.collect(),
        }
    }

    /// Lays another document over this one: what it gives counts, what it leaves out stays.
    pub fn lay(&mut self, over: &Self) {
        for (name, table) in &over.tables {
            match self.tables.get_mut(name) {
                Some(mine) => mine
                    .entries
                    .extend(table.entries.iter().map(|(key, entry)| (key.clone(), entry.clone()))),
                None => {
                    self.tables.insert(name.clone(), table.clone());
                }
            }
        }
    }

    /// Whether a section is there, be it empty.
    pub fn has_section(&self, section: &str) -> bool {
        self.tables.contains_key(section)
    }

    /// Where a key was given, its section in front; `None` if it was not.
    pub fn place_of(&self, key: &str) -> Option<&Place> {
        let (section, name) = key.rsplit_once('.').unwrap_or(("", key));
        self.entry(section, name).map(|entry| &entry.place)
    }
}

/// What follows `section` and its dot in `name`.
fn below<'a>(section: &str, name: &'a str) -> Option<&'a str> {
    name.strip_prefix(section)?
        .strip_prefix('.')
        .filter(|rest| !rest.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "[laws.b.arbiter]\nlaw = 'x'\n[laws]\na = { arbiter.law = 'y', arbiter.floor = 1 }\n[other]\n";

    fn document() -> Document {
        Document::parse("plan.toml", TEXT).unwrap()
    }

    fn names(document: &Document, section: &str) -> Vec<String> {
        let found = document.sections_in(section).unwrap();
        found.into_iter().map(|(name, _)| name).collect()
    }

    #[test]
    fn sections_are_named_in_the_order_of_the_text() {
        assert_eq!(names(&document(), "laws"), ["b", "a"]);
        assert_eq!(names(&document(), "laws.a"), ["arbiter"]);
        assert!(names(&document(), "nothing").is_empty());
        let quoted = Document::parse("plan.toml", "[laws.'a.b'.c]").unwrap();
        assert!(names(&quoted, "laws").iter().all(|name| name.starts_with('"')));
    }

    #[test]
    fn a_value_where_a_section_belongs_is_refused_with_its_place() {
        let document = Document::parse("plan.toml", "[laws]\na = 5").unwrap();
        let refused = document.sections_in("laws").unwrap_err().to_string();
        assert_eq!(
            refused,
            "plan.toml:2:5: laws.a should be a section, found a whole number"
        );
    }

    #[test]
    fn what_lies_on_top_counts_and_keeps_its_place_and_full_name() {
        let mut low = document().below("laws.a");
        low.lay(&document().below("laws.b"));
        assert_eq!(low.place_of("arbiter.law").unwrap().to_string(), "plan.toml:2:1");
        assert_eq!(low.place_of("arbiter.floor").unwrap().to_string(), "plan.toml:4:34");
        let refused = low.finish(&[]).unwrap_err().to_string();
        assert!(refused.contains("unknown section arbiter"), "{refused}");
    }
}

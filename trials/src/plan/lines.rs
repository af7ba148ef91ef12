//! What befalls the messages of which trials, in words.

use super::{Condition, Context, Plan};

impl Plan {
    /// The trials whose streams have bad lines, and these lines: those of a condition, or, where contexts differ, of a
    /// condition in a context.
    #[must_use]
    pub fn bad_lines(&self) -> Vec<(String, String)> {
        let all = self.conditions.iter().flat_map(|condition| self.lines_of(condition));
        all.filter(|(_, line)| !line.is_empty()).collect()
    }

    fn lines_of(&self, condition: &Condition) -> Vec<(String, String)> {
        let line = |context: &Context| {
            let laid = self.configuration(condition, context);
            laid.map_or_else(|why| why.to_string(), |laid| laid.impairment.to_string())
        };
        let lines: Vec<String> = self.contexts.iter().map(line).collect();
        match lines.first() {
            Some(first) if lines.iter().all(|line| line == first) => vec![(condition.name.clone(), first.clone())],
            _ => {
                let names = self
                    .contexts
                    .iter()
                    .map(|context| format!("{} {}", condition.name, context.name));
                names.zip(lines).collect()
            }
        }
    }
}

//! Sites as their users meet them: made, copied, spoilt, asked.

mod folders;
mod garbage;
mod privilege;

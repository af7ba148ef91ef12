//! What it takes to build a node again: a metadata record for each, and its model as an attachment.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{Seek, Write};

use mcap::Attachment;
use sha2::{Digest, Sha256};
use tandem_wire::{Nanos, NodeInfo, NodeName};

use super::channels::Channels;
use super::{WriteError, hex};

/// What was written down of the nodes so far.
#[derive(Default)]
pub(super) struct Nodes {
    infos: BTreeMap<NodeName, NodeInfo>,
    models: BTreeSet<[u8; 32]>,
}

impl Nodes {
    /// Writes a node's information once, and again when it changes: it is asked for more often than that.
    pub(super) fn keep<W: Write + Seek>(
        &mut self,
        channels: &mut Channels<W>,
        at: Nanos,
        node: NodeName,
        info: &NodeInfo,
    ) -> Result<(), WriteError> {
        if self.infos.get(&node) == Some(info) {
            return Ok(());
        }
        let mut fields = BTreeMap::from([
            ("session".to_owned(), info.session.0.to_string()),
            ("seed".to_owned(), info.seed.to_string()),
            ("build".to_owned(), info.build.clone()),
            ("config".to_owned(), info.config.clone()),
        ]);
        if !info.model.is_empty() {
            let hash: [u8; 32] = Sha256::digest(&info.model).into();
            fields.insert("model_sha256".to_owned(), hex(&hash));
            self.attach(channels, at, hash, &info.model)?;
        }
        channels.write_metadata(format!("tandem.node.{node}"), fields)?;
        self.infos.insert(node, info.clone());
        Ok(())
    }

    /// Attaches a model, once.
    fn attach<W: Write + Seek>(
        &mut self,
        channels: &mut Channels<W>,
        at: Nanos,
        hash: [u8; 32],
        model: &[u8],
    ) -> Result<(), WriteError> {
        if !self.models.insert(hash) {
            return Ok(());
        }
        channels.attach(&Attachment {
            log_time: at,
            create_time: at,
            name: format!("model-{}.cesn", hex(&hash[..8])),
            media_type: "application/octet-stream".to_owned(),
            data: Cow::Borrowed(model),
        })
    }
}

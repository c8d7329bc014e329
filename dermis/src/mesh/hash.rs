//! A fingerprint of a mesh.

use crate::mesh::{Cells, ElectrodePatch, Mesh};

/// FNV-1a with 128 bits (Fowler, Noll and Vo): the same on every machine and in every version.
struct Fnv(u128);

impl Fnv {
    const OFFSET: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
    const PRIME: u128 = 0x0000_0000_0100_0000_0000_0000_0000_013b;

    fn bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u128::from(byte)).wrapping_mul(Self::PRIME);
        }
    }

    fn numbers(&mut self, numbers: impl IntoIterator<Item = usize>) {
        numbers.into_iter().for_each(|number| self.bytes(&(number as u64).to_le_bytes()));
    }
}

impl Mesh {
    /// 32 hexadecimal digits that depend on every bit of the mesh: positions, cells, electrodes and regions, in their
    /// order. They identify the mesh of data or models; they do not protect against forgery.
    pub fn hash(&self) -> String {
        let mut hash = Fnv(Fnv::OFFSET);
        hash.numbers([self.node_count()]);
        self.nodes.iter().flatten().for_each(|x| hash.bytes(&x.to_bits().to_le_bytes()));
        match &self.cells {
            Cells::Triangles(cells) => {
                hash.numbers([3, cells.len()].into_iter().chain(cells.iter().flatten().copied()))
            }
            Cells::Tetrahedra(cells) => {
                hash.numbers([4, cells.len()].into_iter().chain(cells.iter().flatten().copied()))
            }
        }
        hash.numbers([self.electrodes.len()]);
        for patch in &self.electrodes {
            match patch {
                ElectrodePatch::Cells(list) => hash.numbers([0, list.len()].into_iter().chain(list.iter().copied())),
                ElectrodePatch::Edges(list) => {
                    hash.numbers([1, list.len()].into_iter().chain(list.iter().flatten().copied()));
                }
                ElectrodePatch::Faces(list) => {
                    hash.numbers([2, list.len()].into_iter().chain(list.iter().flatten().copied()));
                }
                ElectrodePatch::Node(node) => hash.numbers([3, *node]),
            }
        }
        for (name, cells) in &self.regions {
            hash.numbers([name.len()]);
            hash.bytes(name.as_bytes());
            hash.numbers([cells.len()].into_iter().chain(cells.iter().copied()));
        }
        format!("{:032x}", hash.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fingerprint_of_bytes_is_that_of_the_standard() {
        // The authors' published values of the 128-bit FNV-1a of "" and of "a".
        let of = |bytes: &[u8]| {
            let mut hash = Fnv(Fnv::OFFSET);
            hash.bytes(bytes);
            format!("{:032x}", hash.0)
        };
        assert_eq!(of(b""), "6c62272e07bb014262b821756295c58d");
        assert_eq!(of(b"a"), "d228cb696f1a8caf78912b704e4a8964");
    }

    #[test]
    fn every_part_of_a_mesh_counts() {
        let mesh = Mesh {
            nodes: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            cells: Cells::Triangles(vec![[0, 1, 2]]),
            electrodes: vec![ElectrodePatch::Node(0)],
            regions: vec![("a".into(), vec![0])],
        };
        let mut others = vec![mesh.clone(); 5];
        others[0].nodes[1][0] = f64::from_bits(1.0f64.to_bits() + 1);
        others[1].cells = Cells::Triangles(vec![[1, 2, 0]]);
        others[2].electrodes = vec![ElectrodePatch::Node(1)];
        others[3].regions[0].0 = "b".into();
        others[4].electrodes = vec![ElectrodePatch::Edges(vec![[0, 1]])];
        for other in others {
            assert_ne!(mesh.hash(), other.hash());
        }
        assert_eq!(mesh.hash(), mesh.clone().hash());
    }
}

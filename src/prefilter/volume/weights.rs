//! What the optimiser finds: a factor a cluster and lobe, and a colour a cluster (\[WU19\] 3.13, 3.21).

use super::clusters::Clusters;
use crate::medium::{MAX_LOBES, Medium};

/// Weight factors w_kj and colour scales s_k; an albedo becomes min(1, ᾱ·w_kj·s_k).
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// w, `[cluster][lobe]`.
    pub factors: Vec<[f64; MAX_LOBES]>,
    /// s, `[cluster]`, RGB.
    pub colours: Vec<[f64; 3]>,
    /// Lobes that are used.
    pub lobe_count: usize,
}

impl Weights {
    /// Weights that change nothing: the naive level.
    pub fn ones(clusters: usize, lobe_count: usize) -> Self {
        Self { factors: vec![[1.0; MAX_LOBES]; clusters], colours: vec![[1.0; 3]; clusters], lobe_count }
    }

    /// How many unknowns there are: all w, then all s.
    pub fn unknowns(&self) -> usize {
        self.factors.len() * (self.lobe_count + 3)
    }

    /// Place of w_kj among the unknowns.
    #[inline]
    pub fn factor_place(&self, cluster: usize, lobe: usize) -> usize {
        cluster * self.lobe_count + lobe
    }

    /// Place of s_kc among the unknowns.
    #[inline]
    pub fn colour_place(&self, cluster: usize, channel: usize) -> usize {
        self.factors.len() * self.lobe_count + 3 * cluster + channel
    }

    /// The logarithms of the unknowns, in the order of their places: fits step in these, so that weights stay positive.
    pub fn logarithms(&self) -> Vec<f64> {
        let w = self.factors.iter().flat_map(|w| w[..self.lobe_count].iter().copied());
        w.chain(self.colours.iter().flatten().copied()).map(f64::ln).collect()
    }

    /// The weights of these logarithms.
    pub fn from_logarithms(&self, logarithms: &[f64]) -> Self {
        assert_eq!(logarithms.len(), self.unknowns(), "one a weight");
        let mut weights = self.clone();
        for k in 0..self.factors.len() {
            (0..self.lobe_count).for_each(|j| weights.factors[k][j] = logarithms[self.factor_place(k, j)].exp());
            (0..3).for_each(|c| weights.colours[k][c] = logarithms[self.colour_place(k, c)].exp());
        }
        weights
    }

    /// min(1, albedo·w_kj·s_k), and whether each channel moves with the weights: at 1 it does, if only downwards.
    #[inline]
    pub fn albedo(&self, cluster: usize, lobe: usize, albedo: [f32; 3]) -> ([f64; 3], [bool; 3]) {
        let scaled: [f64; 3] =
            std::array::from_fn(|c| f64::from(albedo[c]) * self.factors[cluster][lobe] * self.colours[cluster][c]);
        (scaled.map(|a| a.min(1.0)), scaled.map(|a| a <= 1.0))
    }

    /// `coarse` with these weights in its albedos.
    pub fn apply(&self, coarse: &Medium, clusters: &Clusters) -> Medium {
        coarse.with_albedos(|index, j| {
            let albedo = coarse.voxel(index).lobes()[j].albedo;
            self.albedo(usize::from(clusters.of_voxel[index]), j, albedo).0.map(|a| a as f32)
        })
    }
}

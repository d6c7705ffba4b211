"""MobileFaceNet, with the parameter names of InsightFace_Pytorch, so that its published weights can be loaded.

Source: Chen et al., "MobileFaceNets", CCBR 2018, Table 1, with twice as many channels in `conv_4`'s and `conv_5`'s
bottlenecks as in their input, as there.
"""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn.functional import normalize


class ConvBlock(nn.Module):
    """A convolution, normalised, and without PReLU where it is linear."""

    def __init__(
        self, width_in: int, width: int, kernel: int, stride: int, padding: int, groups: int = 1, linear: bool = False
    ) -> None:
        super().__init__()
        self.conv = nn.Conv2d(width_in, width, kernel, stride, padding, groups=groups, bias=False)
        self.bn = nn.BatchNorm2d(width)
        self.prelu: nn.Module | None = None if linear else nn.PReLU(width)

    def forward(self, x: Tensor) -> Tensor:
        normalised: Tensor = self.bn(self.conv(x))
        if self.prelu is None:
            return normalised
        answer: Tensor = self.prelu(normalised)
        return answer


class DepthWise(nn.Module):
    """A bottleneck: wider by a 1 x 1 convolution, one filter a channel, narrower again. inner: channels inside."""

    def __init__(self, width_in: int, width: int, inner: int, stride: int) -> None:
        super().__init__()
        self.conv = ConvBlock(width_in, inner, 1, 1, 0)
        self.conv_dw = ConvBlock(inner, inner, 3, stride, 1, groups=inner)
        self.project = ConvBlock(inner, width, 1, 1, 0, linear=True)
        self.residual = stride == 1

    def forward(self, x: Tensor) -> Tensor:
        inner: Tensor = self.project(self.conv_dw(self.conv(x)))
        return x + inner if self.residual else inner


class Residual(nn.Module):
    """A row of bottlenecks, each beside a shortcut."""

    def __init__(self, width: int, blocks: int, inner: int) -> None:
        super().__init__()
        self.model = nn.Sequential(*(DepthWise(width, width, inner, 1) for _ in range(blocks)))

    def forward(self, x: Tensor) -> Tensor:
        answer: Tensor = self.model(x)
        return answer


class MobileFaceNet(nn.Module):
    """Pictures of faces (n, 3, 112, 112), from -1 to 1, to n rows of `width` values, each row of length 1."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.conv1 = ConvBlock(3, 64, 3, 2, 1)
        self.conv2_dw = ConvBlock(64, 64, 3, 1, 1, groups=64)
        self.conv_23 = DepthWise(64, 64, 128, 2)
        self.conv_3 = Residual(64, 4, 128)
        self.conv_34 = DepthWise(64, 128, 256, 2)
        self.conv_4 = Residual(128, 6, 256)
        self.conv_45 = DepthWise(128, 128, 512, 2)
        self.conv_5 = Residual(128, 2, 256)
        self.conv_6_sep = ConvBlock(128, 512, 1, 1, 0)
        self.conv_6_dw = ConvBlock(512, 512, 7, 1, 0, groups=512, linear=True)
        self.linear = nn.Linear(512, width, bias=False)
        self.bn = nn.BatchNorm1d(width)

    def features(self, x: Tensor) -> Tensor:
        """Return what the network answers; its last layer is a part of the embedding."""
        return self(x)  # type: ignore[no-any-return]

    def forward(self, x: Tensor) -> Tensor:
        x = self.conv2_dw(self.conv1(x))
        x = self.conv_4(self.conv_34(self.conv_3(self.conv_23(x))))
        x = self.conv_6_dw(self.conv_6_sep(self.conv_5(self.conv_45(x)))).flatten(1)
        return normalize(self.bn(self.linear(x)))

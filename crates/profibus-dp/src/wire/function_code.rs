//! The FC octet of SD1, SD2 and SD3 telegrams.
//!
//! | bits | request (bit 6 = 1) | response (bit 6 = 0) |
//! |------|---------------------|----------------------|
//! | 7    | 0 (1: clock value)  | 0 |
//! | 5, 4 | FCB, FCV            | station type, 00 = passive |
//! | 3..0 | function            | code |

/// The FC octet as it stands on the wire.
#[doc(alias = "FC")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct FunctionCode(pub u8);

/// What a request asks of the link layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Function {
    /// Send data with acknowledge, low or high priority (3, 5).
    #[doc(alias = "SDA")]
    SendDataWithAcknowledge,
    /// Send data with no acknowledge, low or high priority (4, 6).
    #[doc(alias = "SDN")]
    SendDataNoAcknowledge,
    /// Request FDL status (9).
    FdlStatus,
    /// Send and request data, low or high priority (C, D).
    #[doc(alias = "SRD")]
    SendAndRequestData,
    /// Request Ident (E).
    Ident,
    /// Request LSAP status (F).
    LsapStatus,
    /// Anything a DP-V0 slave never answers: time services, multicast, reserved codes.
    Other,
}

impl FunctionCode {
    const REQUEST: u8 = 0x40;
    const FCB: u8 = 0x20;
    const FCV: u8 = 0x10;

    /// Bit 6: a request, not a response.
    pub const fn is_request(self) -> bool {
        self.0 & Self::REQUEST != 0
    }

    /// A Send and Request Data request, low or high priority: what all DP services are.
    pub const fn is_srd_request(self) -> bool {
        self.0 & 0xCE == 0x4C
    }

    /// The frame count bit.
    #[doc(alias = "FCB")]
    pub const fn frame_count_bit(self) -> bool {
        self.0 & Self::FCB != 0
    }

    /// Whether the frame count bit is valid.
    #[doc(alias = "FCV")]
    pub const fn frame_count_valid(self) -> bool {
        self.0 & Self::FCV != 0
    }

    /// What a request asks for; [`Function::Other`] where bit 7 is set.
    pub const fn function(self) -> Function {
        match self.0 & 0x8F {
            0x3 | 0x5 => Function::SendDataWithAcknowledge,
            0x4 | 0x6 => Function::SendDataNoAcknowledge,
            0x9 => Function::FdlStatus,
            0xC | 0xD => Function::SendAndRequestData,
            0xE => Function::Ident,
            0xF => Function::LsapStatus,
            _ => Function::Other,
        }
    }

    /// The octet without FCV: what, besides address and SAPs, a retry has in common with
    /// its first transmission.
    pub(crate) const fn without_fcv(self) -> u8 {
        self.0 & !Self::FCV
    }
}

/// The code of a slave's response, station type 00 (passive).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum ResponseCode {
    /// 0: positive acknowledgement, the answer to an FDL status request.
    Ok = 0x00,
    /// 1: user error.
    #[doc(alias = "UE")]
    UserError = 0x01,
    /// 2: no resource for the data sent.
    #[doc(alias = "RR")]
    NoResource = 0x02,
    /// 3: no service activated at this SAP, in this state, for this master.
    #[doc(alias = "RS")]
    NoService = 0x03,
    /// 8: response data, low priority.
    #[doc(alias = "DL")]
    DataLow = 0x08,
    /// 9: no response data.
    #[doc(alias = "NR")]
    NoResponseData = 0x09,
    /// A: response data, high priority: a diagnosis waits to be fetched.
    #[doc(alias = "DH")]
    DataHigh = 0x0A,
}

#[cfg(test)]
mod tests {
    use super::*;

    // DP slave reference, section 2.1: the FC values that occur.
    #[test]
    fn the_values_of_the_reference_read_as_told() {
        for (fc, fcv, fcb) in
            [(0x6C, false, true), (0x7D, true, true), (0x5D, true, false), (0x4D, false, false)]
        {
            let code = FunctionCode(fc);
            assert!(code.is_request() && code.is_srd_request());
            assert_eq!(code.function(), Function::SendAndRequestData);
            assert_eq!((code.frame_count_valid(), code.frame_count_bit()), (fcv, fcb), "{fc:02X}");
        }
        assert_eq!(FunctionCode(0x49).function(), Function::FdlStatus);
        assert_eq!(FunctionCode(0x4E).function(), Function::Ident);
        assert_eq!(FunctionCode(0x4F).function(), Function::LsapStatus);
        assert_eq!(FunctionCode(0x46).function(), Function::SendDataNoAcknowledge);
        assert_eq!(FunctionCode(0x44).function(), Function::SendDataNoAcknowledge);
        assert!(!FunctionCode(0x08).is_request());
    }

    #[test]
    fn an_srd_request_is_one_function_of_a_request() {
        for fc in 0..=255 {
            let code = FunctionCode(fc);
            let due = code.is_request() && code.function() == Function::SendAndRequestData;
            assert_eq!(code.is_srd_request(), due, "{fc:02X}");
        }
    }

    #[test]
    fn reserved_codes_and_time_services_are_other() {
        for fc in [0x40, 0xC0, 0x41, 0x42, 0x47, 0x48, 0x4A, 0x4B, 0xCD, 0xC9] {
            assert_eq!(FunctionCode(fc).function(), Function::Other, "{fc:02X}");
            assert!(!FunctionCode(fc).is_srd_request(), "{fc:02X}");
        }
    }
}
